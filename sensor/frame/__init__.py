"""Cameras that read frames of electrons: CMOS, sCMOS, CCD and EMCCD."""

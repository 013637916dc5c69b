"""Gratings, boards, the motion bench and panoramas."""

"""Gratings, boards, the motion bench, panoramas and pictures."""

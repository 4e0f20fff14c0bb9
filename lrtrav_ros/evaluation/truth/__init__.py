"""Frames with ground truth, in every layout that is read."""

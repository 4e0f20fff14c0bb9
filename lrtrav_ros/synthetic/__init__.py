"""Synthetic stereo sequences with exact disparity and ground truth."""

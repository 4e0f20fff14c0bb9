"""Methods, their scores on frames with ground truth, and the folder that keeps them."""

"""Labels of the truth, and the rule for unknown pixels."""

import numpy as np
import pytest

from lrtrav_ros.evaluation.truth.labels import Labels, apply_unknown_rule, decode_truth


def image(*rows):
    return np.array(rows, np.uint8)


def test_labels_are_decoded_and_unknown_follows_the_rule():
    raw = np.array([[0, 1, 2], [1, 0, 0]], np.int16)
    truth = decode_truth(raw, Labels(traversable=0, not_traversable=1, unknown=2))
    assert truth.tolist() == [[255, 0, 128], [0, 255, 255]]
    assert apply_unknown_rule(truth, "ignore").tolist() == truth.tolist()
    assert apply_unknown_rule(truth, "not-traversable").tolist() == [[255, 0, 0], [0, 255, 255]]
    assert decode_truth(truth, Labels()).tolist() == truth.tolist()


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda: Labels(1, 1, 2), "labels are 1,1,2; give three different values"),
        (lambda: decode_truth(image([0, 7]), Labels()), "value 7, but its labels are 255,0,128"),
        (lambda: decode_truth(np.zeros((2, 3, 3), np.uint8), Labels()), r"shape \(2, 3, 3\)"),
    ],
)
def test_bad_truth_is_refused(function, message):
    with pytest.raises(ValueError, match=message):
        function()

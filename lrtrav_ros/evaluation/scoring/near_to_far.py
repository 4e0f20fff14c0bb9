"""Near-to-far learning: a classifier that is trained anew on each frame, by what short range says of it.

The baseline that the paper compares with; after Procopio, Mulligan and Grudic, Journal of Field Robotics 2009. It needs
scikit-learn, which the extra ``[evaluation]`` installs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.method.ground import GROUND, OBSTACLE
from lrtrav_ros.numerics.blas import one_blas_thread
from lrtrav_ros.numerics.checks import check_array, check_labels

_INVERSE_REGULARISATION = 100.0
_MAX_ITERATIONS = 1000
_MOST = 1.001  # in a bin of a histogram with sum 1, rounding included


def classify_superpixels(
    histograms: NDArray[np.float32], superpixels: NDArray[np.int32], occupancy: NDArray[np.uint8]
) -> NDArray[np.bool_]:
    """Return whether each superpixel is traversable, by logistic regression.

    Examples are the superpixels of which short range judges some pixels, ground where more than half of those are; each
    weighs as much as it has judged pixels. With examples of one class alone all superpixels are of that class, and
    without examples none is traversable.

    Parameters
    ----------
    histograms : (n, bins) ndarray of float32
        Features of each superpixel, each histogram with sum 1.
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    occupancy : (H, W) ndarray of uint8
        Short range: 0 ground, 100 obstacle, 255 unknown.

    Returns
    -------
    (n,) ndarray of bool

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or the two images differ in size.
    """
    check_array("histograms", histograms, np.float32, ("n", "bins"))
    low, high = float(histograms.min()), float(histograms.max())
    if not 0 <= low <= high <= _MOST:
        raise ValueError(f"histograms hold values from {low:g} to {high:g}; give rows with sum 1")
    n = len(histograms)
    check_array("superpixels", superpixels, np.int32, ("H", "W"))
    check_array("occupancy", occupancy, np.uint8, superpixels.shape)
    check_labels("superpixels", superpixels, n)
    ground = np.bincount(superpixels[occupancy == GROUND], minlength=n)
    judged = ground + np.bincount(superpixels[occupancy == OBSTACLE], minlength=n)
    examples = judged > 0
    labels = 2 * ground > judged
    if len(np.unique(labels[examples])) < 2:
        return np.full(n, bool(labels.any()))
    # The Euclidean distance of square roots is Hellinger's: bins that are rare count as well.
    features = np.sqrt(histograms.astype(np.float64))
    return _train_and_predict(features, labels, examples, judged / judged[examples].mean())


@one_blas_thread()
def _train_and_predict(
    features: NDArray[np.float64],
    labels: NDArray[np.bool_],
    examples: NDArray[np.bool_],
    weights: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Return the class of all items after training on the examples."""
    from sklearn.linear_model import LogisticRegression  # an extra

    classifier = LogisticRegression(C=_INVERSE_REGULARISATION, max_iter=_MAX_ITERATIONS)
    classifier.fit(features[examples], labels[examples], sample_weight=weights[examples])
    return np.asarray(classifier.predict(features), np.bool_)

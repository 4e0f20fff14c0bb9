"""Small images whose superpixels are known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def quadrants() -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Return a noisy 40 x 42 BGR image of red, green, blue and rough grey quadrants, and their labels."""
    rng = np.random.default_rng(0)
    labels = np.zeros((40, 42), np.int32)
    labels[:20, 21:], labels[20:, :21], labels[20:, 21:] = 1, 2, 3
    colours = np.array([[20, 20, 200], [20, 200, 20], [200, 20, 20], [100, 100, 100]])
    noise = rng.integers(-4, 5, (40, 42, 1)) * np.where(labels == 3, 12, 1)[..., None]
    return np.clip(colours[labels] + noise, 0, 255).astype(np.uint8), labels

"""Tests of the texture descriptors, against their formulas."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from lrtrav_ros.method.textures import (
    centre_symmetric_pattern,
    local_binary_pattern,
    local_homogeneity,
    local_ternary_patterns,
    weber_descriptor,
)


def test_weber_descriptor_is_the_formula() -> None:
    grey = np.random.default_rng(0).integers(0, 256, (12, 15), np.uint8)
    grey[3, 4] = 0
    found = weber_descriptor(grey)
    values = grey.astype(float)
    for v, u in itertools.product(range(1, 11), range(1, 14)):
        if grey[v, u]:
            around = values[v - 1 : v + 2, u - 1 : u + 2]
            angle = np.arctan((3 * (around - values[v, u]) / values[v, u]).sum())
            assert found[v, u] == round((angle / np.pi + 0.5) * 255)
    assert found[3, 4] == 255  # a black centre among brighter neighbours


@pytest.mark.parametrize("level", [0, 1, 128, 255])
def test_weber_descriptor_of_a_flat_image_is_the_middle(level: int) -> None:
    np.testing.assert_array_equal(weber_descriptor(np.full((7, 9), level, np.uint8)), 128)


def test_weber_descriptor_does_not_change_with_brightness() -> None:
    grey = np.random.default_rng(0).integers(40, 64, (20, 25), np.uint8)
    np.testing.assert_array_equal(weber_descriptor(grey), weber_descriptor(grey * 2))


def test_binary_patterns_of_a_bright_right_side() -> None:
    grey = np.array([[10, 10, 200]] * 3, np.uint8)
    assert local_binary_pattern(grey)[1, 1] == 0b11111111  # all are at least as bright as the centre
    assert local_binary_pattern(grey)[1, 2] == 0b00111110  # what lies left is darker; edges repeat
    upper, lower = local_ternary_patterns(grey)
    assert (upper[1, 1], lower[1, 1]) == (0b00011100, 0)
    assert (upper[1, 2], lower[1, 2]) == (0, 0b11000001)
    assert centre_symmetric_pattern(grey)[1, 1] == 0b1100


def test_homogeneity_is_least_at_the_strongest_edge() -> None:
    grey = np.zeros((20, 30), np.uint8)
    grey[:, 15:] = 255
    found = local_homogeneity(grey)
    assert found[:, :10].min() == 255
    assert found[10, 14:16].max() == 0

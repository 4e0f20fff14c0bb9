"""Studies: full comparisons of the choices of one setting, which the paper only summarises."""

from __future__ import annotations

from collections.abc import Iterable

from lrtrav_ros.config import find_parameter
from lrtrav_ros.evaluation.scoring.methods import Method, find_by_superpixels

STUDIES = {"texture": "features.texture", "distance": "features.distance"}
"""The parameter of each study."""


def study_methods(methods: Iterable[Method], study: str) -> list[Method]:
    """Return each method with each choice of a parameter.

    Parameters
    ----------
    methods : iterable of Method
        Methods that cluster superpixels.
    study : str
        Out of `STUDIES`.

    Raises
    ------
    ValueError
        If a method does not cluster superpixels, and so does not depend on the parameter.
    """
    parameter = find_parameter(STUDIES[study])
    variants = []
    for method in methods:
        if method.find is not find_by_superpixels:
            raise ValueError(f"{method.name} does not cluster superpixels; study another method, such as proposed")
        variants += [method.with_setting(parameter.name, choice) for choice in parameter.choices]
    return variants

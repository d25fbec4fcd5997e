"""The names that a newcomer begins with are there, and no name means two things."""

import re
from itertools import combinations
from types import ModuleType

import pytest

import dynamics
import estimators
import vision

PACKAGES = (dynamics, estimators, vision)


def first_tier(package: ModuleType) -> list[str]:
    """The names in the list that ends a package's docstring."""
    listed = (package.__doc__ or "").split("Names to start with:\n\n")[1]
    return [name for line in listed.splitlines() for name in re.split(r"  +", line.strip())[0].split(", ") if name]


@pytest.mark.parametrize("package", PACKAGES, ids=lambda one: one.__name__)
def test_all_public_names_are_there_and_those_to_start_with_are_a_dozen(package: ModuleType) -> None:
    names = first_tier(package)
    assert 10 <= len(names) <= 16
    assert set(names) <= set(package.__all__)
    assert all(getattr(package, name).__doc__ for name in names)
    assert len(set(package.__all__)) == len(package.__all__)
    assert all(hasattr(package, name) for name in package.__all__)


def test_no_name_means_two_things() -> None:
    for one, other in combinations(PACKAGES, 2):
        assert not set(one.__all__) & set(other.__all__)

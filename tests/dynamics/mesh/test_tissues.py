"""Constants of tissues: within what their sources report, and the sources are listed."""

import re
from pathlib import Path

from dynamics.mesh import tissues

ROOT = Path(__file__).parents[3]


def test_each_is_within_the_range_of_its_sources() -> None:
    assert (
        set(tissues.TISSUES) == {"skin", "fat", "gland", "fibrous", "fascia", "muscle"} == set(tissues.YOUNG_RANGE_PA)
    )
    for name, (low, high) in tissues.YOUNG_RANGE_PA.items():
        assert low <= tissues.TISSUES[name].young_pa <= high
        assert 900.0 < tissues.TISSUES[name].density_kg_m3 < 1200.0
        assert tissues.TISSUES[name].poisson <= 0.49


def test_sources_are_listed() -> None:
    listed = (ROOT / "REFERENCES.md").read_text(encoding="utf-8")
    named = set(re.findall(r"[a-z]+\d{4}", Path(tissues.__file__).read_text(encoding="utf-8")))
    assert len(named) == 5
    for key in named:
        assert f"\n| {key} |" in listed

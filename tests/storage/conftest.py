"""Rig with a single rod for tests of tables."""

from pathlib import Path

import pytest

from dpr_lab.rig import Rig, load_rig

ONE_ROD = """
[rig]
name = "one"
L1 = 0.3
[rods]
mounted = "inner"
[parameters.l1]
nominal = 0.15
lower = 0.1
upper = 0.2
[parameters.m1]
nominal = 0.1
lower = 0.05
upper = 0.2
[parameters.c1]
nominal = 1e-4
lower = 1e-5
upper = 1e-3
[parameters.J1]
nominal = 1e-3
lower = 5e-4
upper = 2e-3
[poses.side]
theta1 = 1.5
"""


@pytest.fixture
def one(tmp_path: Path) -> Rig:
    file = tmp_path / "one.toml"
    file.write_text(ONE_ROD)
    return load_rig(file)

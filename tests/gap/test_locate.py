import pytest

from dpr_lab.gap.where.locate import locate


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ({"coulomb_joint2": {"torque_Nm": 1e-3}}, "nearly independent of the load"),
        ({"load_friction_joint2": {"friction_radius_m": 2e-4}}, "increasing with load"),
    ],
)
def test_the_map_by_load_says_whether_load_matters(recorded, bare, effects, said: str) -> None:
    places = locate(*bare(recorded(effects, duration=3.0)))
    (sentence,) = (place.sentence for place in places if (place.site, place.coordinate) == ("joint2", "load"))
    assert "depends on load or on the direction of motion alone" in sentence
    assert sentence.endswith(f"{said}.")

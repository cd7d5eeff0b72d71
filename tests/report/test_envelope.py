import numpy as np

from dpr_lab.report.envelope import POINTS, trace


def test_a_short_record_is_drawn_as_it_is(rng):
    t, y = np.arange(POINTS) / 1000, rng.normal(size=POINTS)

    drawn_t, drawn_y = trace(t, y)

    np.testing.assert_array_equal(drawn_t, t)
    np.testing.assert_array_equal(drawn_y, y)


def test_the_envelope_of_a_long_record_keeps_every_peak_and_adds_none(rng):
    n = 60_007
    t, y = np.sort(rng.uniform(0, 60, n)), rng.normal(size=n)
    y[31_234], y[50_001] = 40.0, -50.0

    drawn_t, drawn_y = trace(t, y)

    real = ~np.isnan(drawn_y)
    assert set(zip(drawn_t[real], drawn_y[real], strict=True)) <= set(zip(t, y, strict=True))
    assert real.sum() <= POINTS + 2
    assert np.all(np.diff(drawn_t) > 0)
    assert {40.0, -50.0} <= set(drawn_y)
    assert (drawn_t[0], drawn_t[-1]) == (t[0], t[-1])


def test_the_envelope_of_a_stretch_is_that_of_the_record(rng):
    t, y = np.arange(48_000) / 1000, np.cumsum(rng.normal(size=48_000))

    drawn_t, drawn_y = trace(t, y)

    for start in range(0, 48, 6):
        inside, drawn = (t >= start) & (t < start + 6), (drawn_t >= start) & (drawn_t < start + 6)
        assert drawn_y[drawn].max() == y[inside].max()
        assert drawn_y[drawn].min() == y[inside].min()


def test_no_line_is_drawn_across_a_gap():
    t = np.arange(2000) / 1000
    t = t[(t < 0.5) | (t > 0.9)]

    drawn_t, drawn_y = trace(t, np.ones_like(t))

    gap = np.flatnonzero(np.isnan(drawn_y))
    assert len(gap) == 1
    assert 0.5 < drawn_t[gap[0]] < 0.9
    assert len(drawn_t) == len(t) + 1


def test_a_single_lost_sample_is_no_gap():
    t = np.delete(np.arange(100) / 1000, 50)

    assert not np.isnan(trace(t, np.ones_like(t))[1]).any()


def test_a_diverging_simulation_is_drawn_up_to_its_last_finite_value():
    t = np.arange(10_000) / 1000
    y = np.where(t < 3, np.sin(t), np.nan)

    drawn_t, drawn_y = trace(t, y)

    assert np.nanmax(drawn_t[~np.isnan(drawn_y)]) > 2.98
    assert np.isnan(drawn_y[drawn_t > 3.01]).all()


def test_an_empty_record_draws_nothing():
    drawn_t, drawn_y = trace(np.empty(0), np.empty(0))

    assert len(drawn_t) == len(drawn_y) == 0

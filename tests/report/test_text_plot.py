import numpy as np

from dpr_lab.report.text_plot import text_chart, text_plot


def test_a_chart_has_the_largest_and_smallest_value_and_the_time_on_its_axes() -> None:
    t = np.linspace(0.0, 8.0, 801)
    y = 0.3 * np.cos(3.0 * t)
    lines = text_chart(t, y, height=4)
    assert len(lines) == 6
    assert lines[0].startswith(" 0.3 rad │")
    assert lines[3].startswith("-0.3 rad │")
    assert [line.split("│")[1] for line in lines[:4]] == text_plot(t, y, height=4)
    assert lines[-1].split() == ["0", "8", "s"]
    assert len({len(line) for line in lines}) == 1


def test_a_constant_column_is_drawn_too() -> None:
    assert text_chart(np.array([0.0, 1.0]), np.array([2.0, 2.0]))[0].startswith("2 rad │")

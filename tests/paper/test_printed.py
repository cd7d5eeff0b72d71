import numpy as np

from dpr_lab.paper.printed import BEST_H, PERCENT_ERRORS, TABLE_1, TABLE_2, TABLE_3, TRUE
from dpr_lab.rig import PARAMETERS, Rig


def test_tables_have_the_papers_rows():
    assert (TABLE_1.shape, TABLE_2.shape, TABLE_3.shape) == ((7, 10), (3, 4), (10, 10))


def test_spot_digits():
    assert TABLE_1[:, -1].tolist() == [0, 78.73, 0.149, 17.45, 52.07, 4.69, 37.35]
    assert TABLE_1[2, PARAMETERS.index("c2")] == 0.0110
    assert TABLE_3[:, -1].tolist() == [
        56.891, 43.2663, 37.3511, 20.4388, 12.1238, 7.16146, 4.69242, 1.21646, 0.86943, 0.07534,
    ]  # fmt: skip
    assert TABLE_3[5, PARAMETERS.index("c1")] == 0.00980
    assert TABLE_2[1].tolist() == [4, 0.149, 164.45, 139.46]
    assert BEST_H == 0.07534


def test_the_printed_percent_errors_are_those_of_the_last_row():
    # J2 = 0.0013281 is 0.143 % off, printed 0.14; m2 = 0.0995 is 0.50 % off.
    np.testing.assert_allclose(np.abs(100 * (TABLE_3[-1, :9] / TRUE - 1)), PERCENT_ERRORS, atol=0.006)


def test_all_rows_but_the_misprints_lie_within_the_bounds(paper: Rig):
    for table, misprint in ((TABLE_1, (2, "c2")), (TABLE_3, (5, "c1"))):
        outside = (table[:, :9] < paper.bounds[0] - 1e-9) | (table[:, :9] > paper.bounds[1] + 1e-9)
        assert [(int(row), PARAMETERS[gene]) for row, gene in np.argwhere(outside)] == [misprint]


def test_the_rig_file_holds_the_papers_parameters(paper: Rig):
    assert np.array_equal(paper.nominal, TRUE)
    np.testing.assert_allclose(paper.bounds, [0.8 * TRUE, 1.2 * TRUE])

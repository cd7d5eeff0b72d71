"""Values that the publication prints (docs/theory.md), with all printed digits.

Parameters are in SI units and in the order of `dpr_lab.rig.PARAMETERS`.
"""

import numpy as np

from dpr_lab.arrays import Array

TRUE = np.array([0.2, 0.2, 0.1, 0.1, 0.208, 0.001, 0.001, 0.00133, 0.00133])
"""(9,) "actual" parameters of section 4.1 of the publication."""

POSES = ("X1", "X2", "X3")

_TABLE_1 = """
0.2   0.2   0.1   0.1   0.208 0.001  0.001   0.00133 0.00133 0
0.176 0.208 0.084 0.088 0.176 0.0009 0.00109 0.00117 0.00138 78.73
0.223 0.207 0.104 0.104 0.224 0.0011 0.0110  0.00143 0.00128 0.149
0.223 0.208 0.106 0.104 0.224 0.0012 0.00106 0.00143 0.00128 17.45
0.196 0.200 0.106 0.108 0.225 0.0010 0.00108 0.00146 0.00141 52.07
0.216 0.200 0.103 0.104 0.212 0.0010 0.00101 0.00136 0.00138 4.69
0.208 0.195 0.102 0.110 0.229 0.0009 0.00102 0.00136 0.00144 37.35
"""

_TABLE_2 = """
1 0     0      0
4 0.149 164.45 139.46
6 4.69  53.195 64.470
"""

_TABLE_3 = """
0.21200 0.20000 0.09071 0.10000 0.24000 0.00104 0.00104 0.0010640 0.0013300 56.8910
0.20240 0.19200 0.11600 0.10557 0.19093 0.00104 0.00092 0.0013548 0.0014896 43.2663
0.20800 0.19513 0.10200 0.11000 0.22880 0.00092 0.00110 0.0013566 0.0014364 37.3511
0.21316 0.19200 0.09400 0.09800 0.19552 0.00108 0.00096 0.0013592 0.0013566 20.4388
0.19000 0.19480 0.09254 0.09400 0.19136 0.00106 0.00092 0.0013257 0.0013310 12.1238
0.19600 0.20000 0.10600 0.10800 0.22464 0.00980 0.00108 0.0014500 0.0014364 7.16146
0.21600 0.20000 0.10319 0.10400 0.21216 0.00104 0.00104 0.0013566 0.0013832 4.69242
0.19874 0.20000 0.09200 0.09800 0.20800 0.00100 0.00099 0.0013598 0.0013182 1.21646
0.19874 0.20000 0.09420 0.09800 0.20800 0.00100 0.00099 0.0013465 0.0013162 0.86943
0.19970 0.20000 0.1010  0.0995  0.2080  0.00101 0.00099 0.0013399 0.0013281 0.07534
"""


def _numbers(text: str) -> Array:
    return np.array([[float(word) for word in line.split()] for line in text.strip().splitlines()])


TABLE_1 = _numbers(_TABLE_1)
"""(7, 10) rows of Table 1: nine parameters and E(Z)."""

TABLE_2 = _numbers(_TABLE_2)
"""(3, 4) rows of Table 2: number of the group in Table 1, and E(Z) from X1, X2 and X3."""

TABLE_3 = _numbers(_TABLE_3)
"""(10, 10) rows of Table 3: nine parameters and H(Z); the best solution is the last row."""

CONTRADICTIONS = (
    "Table 2 gives group 4 the value of row 3 of table 1.",
    "E of table 1 does not follow from its parameters.",
    "H of rows 3 and 7 of table 3 is E of rows 7 and 6 of table 1, which is from one pose.",
    "c2 (table 1, row 3) and c1 (table 3, row 6) are outside the bounds.",
    "Table 3 is sorted by H, but its last row does not have the smallest recomputed E.",
    "A free swing determines five ratios, not nine parameters.",
    "E is summed over 10 s, also of chaotic swings.",
)
"""Contradictions of the publication, each with its evidence in docs/theory.md, section 2."""

PERCENT_ERRORS = np.array([0.15, 0.0, 1.0, 0.5, 0.0, 1.0, 1.0, 0.74, 0.14])
"""(9,) relative errors of the last row of Table 3, %, as printed in section 4.2."""

BEST_H = float(TABLE_3[-1, -1])
"""H of the best published chromosome."""

FIGURES = {
    "figure2": "Figure 2: response of inner and outer rod with the true and with the identified parameters; "
    'the paper says that the curves are "almost overlapped". The pose is not given.',
    "figure3": "Figure 3: error of both angles between the two responses; the paper gives no number.",
    "figure4": "Figure 4: best individual of each generation; the paper describes fast convergence before"
    " generation 100, slower progress with feedback mutation, and a final improvement by dynamic encoding"
    " and variable precision.",
}
"""Contents of the figures by name, according to the publication; the published pictures are not included."""

"""MJCF models with one planted error, recorded in MuJoCo: first cause, and error of free runs of the corrected file.

python benchmarks/simulator_models.py
"""

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.exports.planted_errors import PLANTED, held_out_error
from tests.exports.test_least_change import changed, corrected


def main() -> None:
    """Print a table of all planted errors."""
    print("| planted error | first cause | held-out error before, mrad | after, mrad | reduction | changed |")
    print("|---|---|---|---|---|---|")
    for name, planted in PLANTED.items():
        with tempfile.TemporaryDirectory() as folder:
            least, text, rig = corrected(Path(folder), planted.before, planted.truth)
        first = f"{least.causes[0].quantity}, {least.causes[0].joint}" if least.causes else "none"
        before, after = (1e3 * held_out_error(file, planted.truth, rig) for file in (planted.before, text))
        shown = ", ".join(changed(planted.before, text))
        print(f"| {name} | {first} | {before:.3g} | {after:.2g} | {1 - after / before:.1%} | {shown} |", flush=True)


if __name__ == "__main__":
    main()

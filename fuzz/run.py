"""Coverage-guided fuzzing of a reader (atheris, based on libFuzzer).

    python fuzz/run.py TARGET [--seconds 60]

The search starts from the inputs in `corpus/TARGET`. New inputs are kept in a temporary folder. An input for which a
target fails ends the search and is written to `fuzz/findings`. After the fault is corrected, add the input to the
corpus, so that the tests repeat it.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["dpr_lab", "firmware_protocol", "mcap", "targets"]):
    from targets import TARGETS

HERE = Path(__file__).parent
MOST_BYTES = 1 << 16
MOST_MB = 1024


def main() -> None:
    """Fuzz one target for the requested time."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", choices=TARGETS)
    parser.add_argument("--seconds", type=int, default=60)
    chosen = parser.parse_args()
    findings = HERE / "findings"
    findings.mkdir(exist_ok=True)
    options = {
        "max_total_time": chosen.seconds,
        "max_len": MOST_BYTES,
        "rss_limit_mb": MOST_MB,
        "timeout": 20,
        "artifact_prefix": f"{findings}/{chosen.target}-",
        "print_final_stats": 1,
    }
    with tempfile.TemporaryDirectory() as grown:
        words = [f"-{name}={value}" for name, value in options.items()]
        atheris.Setup([sys.argv[0], *words, grown, str(HERE / "corpus" / chosen.target)], TARGETS[chosen.target])
        atheris.Fuzz()


if __name__ == "__main__":
    main()

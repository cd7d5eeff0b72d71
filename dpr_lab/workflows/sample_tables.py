"""Sample tables of the tutorial: three recorded releases as CSV, and their rig file."""

import shutil
from pathlib import Path

from dpr_lab.errors import ConfigError
from dpr_lab.whole_file import write_whole
from dpr_lab.workflows.checks import refuse_file


def write_sample_tables(out: Path) -> tuple[Path, ...]:
    """Copy the sample tables and their rig file into a folder.

    Args:
        out: the folder, created if missing

    Returns:
        The files, the rig file first.

    Raises:
        ConfigError: a file with this name exists, or the folder cannot be written.
    """
    from dpr_lab.configs import BUILTIN

    refuse_file(out)
    samples = BUILTIN / "tables"
    sources = [samples / "bench.toml", *sorted(samples.glob("*.csv"))]
    taken = [out / source.name for source in sources if (out / source.name).exists()]
    if taken:
        raise ConfigError(f"{taken[0]}: exists already; choose another folder with --out")
    for source in sources:
        write_whole(out / source.name, lambda file, source=source: shutil.copyfile(source, file), ConfigError)
    return tuple(out / source.name for source in sources)

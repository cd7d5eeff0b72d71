"""Sample tables of the tutorials: three releases as CSV, their films, and the rig file."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from dpr_lab.errors import ConfigError
from dpr_lab.whole_file import write_text, write_whole
from dpr_lab.workflows.checks import check_folder_writable


@dataclass(frozen=True, slots=True)
class Film:
    """Settings of the film of a release, and of the tracker of its points."""

    every: int = 2
    """Number of table rows per frame: the film has 100 frames per second."""
    scale: float = 900.0
    """Scale of the picture, pixels per metre."""
    pivot: tuple[float, float] = (960.0, 540.0)
    """Position of joint 1 in the picture, pixels from the left and from the top."""
    noise: float = 0.5
    """Standard deviation of each tracked coordinate, pixels."""


FILM = Film()


def write_sample_tables(out: Path) -> tuple[Path, ...]:
    """Write the sample tables, their film points and rig file into a folder.

    Args:
        out: the folder, created if missing

    Returns:
        the files; the rig file is the first

    Raises:
        ConfigError: a file with this name exists, or the folder cannot be written.
    """
    from dpr_lab.configs import BUILTIN

    check_folder_writable(out)
    samples = BUILTIN / "tables"
    tables = sorted(samples.glob("*.csv"))
    copied = {out / source.name: source for source in (samples / "bench.toml", *tables)}
    films = {out / f"film_{table.name}": table for table in tables}
    for file in (*copied, *films):
        if file.exists():
            raise ConfigError(f"{file}: exists already; choose another folder with --out")
    for file, source in copied.items():
        write_whole(file, lambda path, source=source: shutil.copyfile(source, path), ConfigError)
    for file, table in films.items():
        write_text(file, film_points(table, samples / "bench.toml"), ConfigError)
    return (*copied, *films)


def film_points(table: Path, rig_file: Path) -> str:
    """Return the pivot, elbow and tip points of a filmed release, as CSV in pixels.

    Args:
        table: time, angle of the inner rod from the hanging position, angle of the outer rod relative to it, degrees
        rig_file: rig with the lengths of both rods
    """
    import numpy as np

    from dpr_lab.rig import load_rig

    rig = load_rig(rig_file)
    assert rig.L2 is not None
    t, inner, relative = np.loadtxt(table, delimiter=",", skiprows=1)[:: FILM.every].T
    points = [np.tile(FILM.pivot, (len(t), 1))]
    for length, angle in ((rig.L1, np.radians(inner)), (rig.L2, np.radians(inner + relative))):
        points.append(points[-1] + FILM.scale * length * np.column_stack([np.sin(angle), np.cos(angle)]))
    pixels = np.hstack(points)
    pixels += np.random.default_rng(0).normal(0.0, FILM.noise, pixels.shape)
    rows = (",".join([f"{time:.2f}", *(f"{pixel:.2f}" for pixel in row)]) for time, row in zip(t, pixels, strict=True))
    return "\n".join(["t,pivot_x,pivot_y,elbow_x,elbow_y,tip_x,tip_y", *rows, ""])

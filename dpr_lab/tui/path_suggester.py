"""Completion of paths in an input field."""

from pathlib import Path

from textual.suggester import Suggester


class PathSuggester(Suggester):
    """Suggester that completes a path with the first matching folder or file.

    Only files with the given suffix are suggested. The character `~` stands for the home folder.

    Args:
        suffix: suffix of the files, with its dot; empty for folders only; `*` for all files
    """

    def __init__(self, suffix: str) -> None:
        super().__init__(use_cache=False, case_sensitive=True)
        self._suffix = suffix

    async def get_suggestion(self, value: str) -> str | None:
        """Return the completed input, or None if nothing matches."""
        folder, _, prefix = value.rpartition("/")
        base = Path(f"{folder}/" if "/" in value else ".").expanduser()
        try:
            names = sorted(path for path in base.iterdir() if path.name.startswith(prefix))
        except OSError:
            return None
        fit = (path for path in names if path.is_dir() or self._suffix in ("*", path.suffix or None))
        first = next((f"{path.name}/" if path.is_dir() else path.name for path in fit), None)
        return None if first is None or not value else value[: len(value) - len(prefix)] + first

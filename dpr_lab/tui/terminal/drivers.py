"""Which driver draws: our own for terminals, which never waits for a slow one, and for pages, which end with theirs."""

from textual.driver import Driver


def our_driver(textuals: type[Driver]) -> type[Driver]:
    """Ours in the place of one of Textual's; Textual's own where there is none of ours."""
    if textuals.__name__ == "WebDriver":
        from dpr_lab.tui.terminal.page import PageDriver

        return PageDriver
    if textuals.__name__ == "LinuxDriver":
        from dpr_lab.tui.terminal.driver import BenchDriver  # needs termios, which not every system has

        return BenchDriver
    return textuals

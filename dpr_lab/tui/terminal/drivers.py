"""Selection of the driver: for terminals one that never waits, for browser pages one that ends with its server."""

from textual.driver import Driver


def our_driver(textuals: type[Driver]) -> type[Driver]:
    """Driver of this package in place of a driver of Textual; the driver of Textual if there is none."""
    if textuals.__name__ == "WebDriver":
        from dpr_lab.tui.terminal.page import PageDriver

        return PageDriver
    if textuals.__name__ == "LinuxDriver":
        from dpr_lab.tui.terminal.driver import BenchDriver  # requires termios, which not every system has

        return BenchDriver
    return textuals

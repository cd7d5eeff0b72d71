"""Selection of the driver of the screen: one that never waits for a slow terminal, or one for browser pages."""

from textual.driver import Driver


def our_driver(textuals: type[Driver]) -> type[Driver]:
    """Replacement for a driver of Textual; the original driver if there is no replacement."""
    if textuals.__name__ == "WebDriver":
        from dpr_lab.tui.terminal.page import PageDriver

        return PageDriver
    if textuals.__name__ == "LinuxDriver":
        from dpr_lab.tui.terminal.driver import BenchDriver  # requires termios, which not every system has

        return BenchDriver
    return textuals

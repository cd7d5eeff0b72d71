"""Selection of the terminal driver.

The driver for a terminal never blocks. The driver for a browser ends when its server ends.
"""

from textual.driver import Driver


def our_driver(textuals: type[Driver]) -> type[Driver]:
    """Return the driver of this package that replaces a Textual driver.

    If this package has no replacement, return the Textual driver.
    """
    if textuals.__name__ == "WebDriver":
        from dpr_lab.tui.terminal.page import PageDriver

        return PageDriver
    if textuals.__name__ == "LinuxDriver":
        from dpr_lab.tui.terminal.driver import BenchDriver  # requires termios, which not every system has

        return BenchDriver
    return textuals

"""`python -m tests.on_a_terminal WORDS`: the screen of `dpr-lab WORDS` on a terminal, left as soon as it is drawn."""

import sys

from tests.tui.terminal_emulator import Terminal

terminal = Terminal(sys.argv[1:], {})
terminal.until_shown("Connect")
terminal.press("\x11")  # ctrl+q
sys.exit(terminal.ended())

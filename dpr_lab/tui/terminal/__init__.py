"""Output to the terminal: only changes are sent, no faster than they are drawn, and drawing is confirmed.

frame    cells wanted and cells sent
plain    no control characters in what is drawn
pace     when the next frame may go
display  frames out, the terminal's confirmations in
sight    whether the operator has seen what is shown
multiplexer  programs such as tmux that confirm in place of the operator's terminal
replies  keys, and what the terminal replies when it is asked what it is
writer   bytes to the terminal, without ever waiting for it
driver   Textual's driver with that parser and writer, and an end within a bounded time
"""

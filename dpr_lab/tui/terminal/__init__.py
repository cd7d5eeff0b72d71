"""Between the app and the terminal: only what changed is sent, no faster than it is drawn, and drawn is confirmed.

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

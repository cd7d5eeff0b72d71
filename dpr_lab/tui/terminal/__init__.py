"""Output to the terminal: only changes are sent, and each frame is confirmed.

frame        requested and transmitted content of the cells
plain        removal of control characters
pace         time of the next frame
display      output of frames and their confirmation
sight        evidence that the operator has seen the screen
multiplexer  detection of programs such as tmux that confirm in place of the operator's terminal
replies      keys, and replies to queries of the terminal type
writer       output that never waits for the terminal
driver       Textual's driver with this parser and writer, which ends within a limited time
"""

"""Terminal user interface (`dpr-lab tui`), also called "the screen", in seven steps.

The steps run the same workflows as the command line.

app                  steps in their order, keys, errors as notices
steps                one page for each step
widgets              parts of the pages
jobs, recorder       jobs that run in separate processes
services, workspace  state that the steps share
"""

FRAMES_PER_S = 12
"""Maximum number of redraws of the screen per second. Textual reads TEXTUAL_FPS when it is first imported."""

"""The bench screen: seven steps from the cable to the diagnosis, every action a call that the command line makes too.

app                  steps in their order, keys, errors as notices
steps                one page each
widgets              what pages are made of
jobs, recorder       what runs in processes of their own
services, workspace  what steps share
"""

FRAMES_PER_S = 12
"""Maximum redraws of the screen per second; Textual reads TEXTUAL_FPS when it is first imported."""

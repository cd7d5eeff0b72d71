"""The bench screen: six steps from the cable to the diagnosis, every action a call that the command line makes too."""

FRAMES_PER_S = 12
"""Most redraws of the screen a second; Textual reads TEXTUAL_FPS when it is first imported."""

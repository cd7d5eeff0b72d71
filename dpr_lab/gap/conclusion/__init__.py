"""What is concluded: verdict, intervals, remedies and the description of the recordings."""

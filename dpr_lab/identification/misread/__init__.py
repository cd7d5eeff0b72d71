"""Wrong descriptions of recordings: refusal, or a diagnosis with the option that corrects the description."""

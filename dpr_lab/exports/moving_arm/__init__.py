"""Export a model with a free or driven arm to other programs."""

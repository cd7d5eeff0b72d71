"""Update a diagnosis with the result of a recommended check."""

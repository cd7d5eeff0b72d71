"""Update a diagnosis by the result of a recommended check."""

"""How far the gap closes on recordings that took no part in the fit."""

"""Mechanics: base parameters, equation (1), the arm, integration of one swing and of many, sensitivities."""

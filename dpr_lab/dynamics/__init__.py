"""Mechanics: base parameters, equation (1), the arm, integration of one swing or of many, and sensitivities."""

"""Run blind trials and score the diagnoses.

Random simulated rigs are sealed, recorded, diagnosed and revealed.
"""

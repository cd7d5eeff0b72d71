"""Advice: recommended measurements and recordings that distinguish causes."""

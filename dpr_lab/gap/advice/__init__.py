"""Advice: the next measurement or recording that distinguishes causes."""

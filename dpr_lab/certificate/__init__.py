"""Certificates: a diagnosis that others repeat and compare, claim by claim."""

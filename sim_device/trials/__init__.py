"""Blind trials as the device prepares them: what is drawn, how big its gap is, recorded and sealed."""

"""Operators between function spaces of time: quadrature, spectral layers, U-NO, random fields."""

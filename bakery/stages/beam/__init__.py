"""How a narrow beam spreads."""

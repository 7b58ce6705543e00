"""What tests and benchmarks hold the bakery against: theory in closed form, light followed by brute force, sums by definition."""

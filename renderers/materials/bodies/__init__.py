"""Translucent bodies: milk, wax, skin, soap, with the surfaces and lights around them."""

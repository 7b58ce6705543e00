"""Materials from afar: how far light spreads in them, and from where on their boundary may be a baked surface."""

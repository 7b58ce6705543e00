"""YAML text with places, units, kinds of values, problems: what recipes and scenes share."""

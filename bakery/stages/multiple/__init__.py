"""Light that is scattered three times and more."""

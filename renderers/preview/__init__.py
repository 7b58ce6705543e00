"""The standard preview of an asset."""

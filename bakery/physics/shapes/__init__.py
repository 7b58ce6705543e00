"""Bodies of grains: shapes, meshes and their files."""

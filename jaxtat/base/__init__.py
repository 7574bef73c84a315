"""What every room uses. Nothing is imported here: the command's help needs names, and no JAX."""

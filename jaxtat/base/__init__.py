"""Used by all other packages. Imports nothing here: the help of the command needs no JAX."""

"""The commands: each composes its configuration, calls the library and prints what came of it."""

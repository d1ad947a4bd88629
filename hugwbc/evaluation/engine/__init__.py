"""Run the episodes of a protocol, in one process or many, and keep their results."""

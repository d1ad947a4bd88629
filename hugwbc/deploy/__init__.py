"""Control of a robot by its own low-level messages, and a simulated robot behind the same messages."""

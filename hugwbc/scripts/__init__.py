"""What a robot is asked to do over time: command scripts, hand paths, arm motions, and the shipped scripts."""

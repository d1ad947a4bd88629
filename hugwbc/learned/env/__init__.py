"""The training environment: many H1s, their commands, rewards, curricula and disturbances."""

"""What happens at the extremes: sound, how tight, at what price, or refused, and why."""

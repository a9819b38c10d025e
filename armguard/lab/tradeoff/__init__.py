"""What accuracy costs: one scene, the same states for all, through the ladder of settings."""

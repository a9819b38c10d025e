"""armguard: a real-time safety monitor for robot arms."""

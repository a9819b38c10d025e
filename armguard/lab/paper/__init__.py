"""What the paper that the schedules come from claims of them, measured on a world like its own."""

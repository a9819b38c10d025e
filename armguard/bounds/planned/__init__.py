"""An arm that follows a plan: plans, their check, and the bound on the arm's motion."""

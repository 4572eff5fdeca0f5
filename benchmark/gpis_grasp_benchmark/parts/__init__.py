"""Parts by script: those that ship with the planner."""

"""What light does in one grain."""

"""What the machine beneath may do wrong: signals, locks, caches, files that appear whole, work tried in a child."""

"""Coverage-guided fuzzing of every codec, and the inputs it left behind."""

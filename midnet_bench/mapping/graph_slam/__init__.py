"""Graph SLAM over correlative scan matching, for logs whose wheels slip."""

"""What was seen: records and their files."""

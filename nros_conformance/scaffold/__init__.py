"""What ``new-backend`` writes: a package that installs, is discovered, and passes what it claims."""

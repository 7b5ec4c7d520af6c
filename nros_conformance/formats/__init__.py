"""Reading structured text: places, durations, YAML 1.2, TOML. Knows nothing of backends."""

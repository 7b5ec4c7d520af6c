"""The one place where playing and judging meet: select, play, judge, repeat the inconclusive, collect."""

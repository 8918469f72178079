"""The contract between simulators and trainers: the messages, and how arrays travel in them."""

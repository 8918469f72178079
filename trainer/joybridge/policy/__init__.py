"""What one policy sees, does and remembers: sensors to network input, network output to the device, its episodes.

It imports `ppo`, `layouts` and `config`. Start with `actor.py`, which plays; `policy.py` is the same while it learns.
"""

"""The compiled twin of `joybridge.trainer.ppo.loss`: same results, several times faster."""

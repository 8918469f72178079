"""The compiled twin of the networks, the loss and Adam of PyTorch: same results, several times faster."""

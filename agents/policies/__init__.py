"""What is learned: networks, in torch for training and in NumPy for play, and the folders of runs that hold them."""

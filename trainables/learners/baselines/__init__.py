"""Other ways of using a source in a deep agent: the baselines that transfer is compared with, a file each."""

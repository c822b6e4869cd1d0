"""Power-law noise type at each cluster size, from the lag-1 autocorrelation and, with few averages, from B1."""

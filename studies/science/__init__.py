"""What a simulated study can and cannot show: a page of docs whose figures one command makes."""

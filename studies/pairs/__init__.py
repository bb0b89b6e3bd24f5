"""One muscle's sEMG and the landmarks of a video, scored against predictions without that EMG."""

"""Your pictures, videos and arrays as frames of linear light."""

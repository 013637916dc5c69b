"""Pictures, films and arrays of users, as frames of linear light."""

"""What people do with frames, one folder or module each; none knows another but `realtime`, which serves pages."""

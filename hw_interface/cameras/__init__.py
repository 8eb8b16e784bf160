"""Cameras in processes of their own: sources of pictures, the clock they are stamped by, and what they answer with."""

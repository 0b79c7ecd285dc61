"""The first day of machines as `observer init` configures them: is the error right, and called good?"""

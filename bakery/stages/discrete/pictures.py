def pictures(root):
    return ()

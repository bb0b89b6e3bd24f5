"""Virtual treatment of lips and jaw: plan, excision, closure, weakness, and the movement that is left.

A research model, not validated on patients; not for treatment decisions.
"""

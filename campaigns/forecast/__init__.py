"""Do temperatures and error of the next hour lie within their bands?"""

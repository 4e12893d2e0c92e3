# "yes" where a part file has a `key`: at the start of a line or an entry, not in a comment. A sign #
# within quotation marks begins none, and a text that is no key has none.
{ gsub(/'[^']*#[^']*'|"[^"]*#[^"]*"/, "''"); sub(/(^|[ \t])#.*/, "")
	gsub(/'[^']*'[ \t]*([],}]|$)|"[^"]*"[ \t]*([],}]|$)/, "''") }
$0 ~ "(^|[{,[ \t-])[\"']?" key "[\"']?[ \t]*:" { print "yes"; exit }

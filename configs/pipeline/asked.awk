# "yes" where a part file has a `key`: at the start of a line or an entry, not in a comment. A sign #
# within quotation marks begins none.
{ gsub(/'[^']*#[^']*'|"[^"]*#[^"]*"/, "''"); sub(/(^|[ \t])#.*/, "") }
$0 ~ "(^|[{,[ \t-])[\"']?" key "[\"']?[ \t]*:" { print "yes"; exit }
